"""What stands at the end of the diagram: nothing (task level), a simulated plant, or the robot over LCM."""
