"""The `deabayes` command."""
