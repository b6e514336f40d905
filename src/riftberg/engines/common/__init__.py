"""What both engines share: forces, fragments, land, laws of a user's own, and what a step reads and changes."""
