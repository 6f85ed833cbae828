"""One loader a layout; all return the same ``Scene``."""
