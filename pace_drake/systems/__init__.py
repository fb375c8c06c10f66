"""The systems of the diagram, one LeafSystem a file."""
