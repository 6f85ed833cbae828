"""The mean training image as a method of inverse rendering."""
