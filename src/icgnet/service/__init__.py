"""Predictions over HTTP; needs the extra `serve`. Nothing else in the package imports this folder."""
