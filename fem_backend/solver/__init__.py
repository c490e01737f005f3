"""Equilibrium: linear solvers, Newton and its modifications, load steps with and without history."""
