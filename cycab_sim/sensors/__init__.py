"""Cameras, rigs, scanner, IMU, exposure, and their faults."""
