"""Estimation problems."""
