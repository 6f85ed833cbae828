"""Methods of strangers: published codes that are run as commands (docs/methods_as_commands.md)."""
