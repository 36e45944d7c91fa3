"""Tracks to files: a COLMAP database, or hloc's HDF5 pair."""
