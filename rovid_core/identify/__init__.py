"""What identifies a degree of freedom, and how far its result can be trusted."""
