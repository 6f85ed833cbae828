"""The store: a folder of results in which every file is complete or absent."""
