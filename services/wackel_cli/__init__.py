"""The `wackel` command: one program, one module per subcommand."""
