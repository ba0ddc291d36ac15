"""Scenes to labelled recipes in Parquet."""
