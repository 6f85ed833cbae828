"""Fetches files and data sets: resumed downloads, and unpacking that stays within its folder."""
