"""The parts of the web viewer's page; `icgnet.viewer.web` puts them together."""
