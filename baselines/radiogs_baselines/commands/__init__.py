"""Public codes as methods that are run as commands (docs/your_method.md)."""
