"""Readers and writers of the folders into which public codes write their results; maps are on black."""
