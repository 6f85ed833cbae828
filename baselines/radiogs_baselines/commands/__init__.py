"""Public codes as methods that are run as commands (docs/methods_as_commands.md)."""
