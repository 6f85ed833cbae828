"""The folders that public codes write their results into: read as maps on black, and written in their place."""
