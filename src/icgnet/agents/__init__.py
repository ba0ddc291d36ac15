"""Tools for agents over the Model Context Protocol; needs the extra `mcp`. Only the command line imports this folder."""
