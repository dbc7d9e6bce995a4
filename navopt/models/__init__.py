"""Physics without optimisation."""
