"""The terms of the virtual work; see `tactile_fem.mechanics.terms.term`."""
