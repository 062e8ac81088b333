"""What the plots draw."""
