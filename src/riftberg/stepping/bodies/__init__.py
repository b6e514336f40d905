"""Fragments as rigid bodies: pose, inertia, Newton's method for their velocities."""
