"""The command line: icgnet demo | predict | view | generate | train | objects."""
