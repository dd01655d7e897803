"""The adaptive identifier of Smallwood & Whitcomb (2003)."""
