"""The command `star` and its built-in subcommands."""
