"""Subcommands of `pentimento`: each adds its arguments and imports what it needs when it runs."""
