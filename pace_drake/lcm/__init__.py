"""LCM: opening a URL safely, and the senders that meet the contract of the robot's drivers."""
