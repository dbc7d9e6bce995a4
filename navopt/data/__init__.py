"""Embedded gravity grids."""
