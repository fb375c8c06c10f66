"""The ``pace`` command: one thin module per verb."""
