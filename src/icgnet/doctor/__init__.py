"""What is said about an installation: what is there, what is missing, and whether it works."""
