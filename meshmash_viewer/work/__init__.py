"""Work outside the calling process."""
