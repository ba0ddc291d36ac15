"""Pictures and the web viewer."""
