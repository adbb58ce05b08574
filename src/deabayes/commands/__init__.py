"""The subcommands of `deabayes`, each a thin layer over one function of the library."""
