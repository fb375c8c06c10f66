"""The driver between LCM and libfranka: it moves a Franka robot on PANDA_COMMAND and reports on PANDA_STATUS."""
