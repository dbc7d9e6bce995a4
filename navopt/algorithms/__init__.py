"""Swarm algorithms and anchors, all pymoo algorithms."""
