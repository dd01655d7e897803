"""Reading and writing logs of every container, also broken ones."""
