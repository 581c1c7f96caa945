"""Names of schemes and solvers on the command line."""
