"""Contact: broad phase, islands of fragments in contact, impulses, the constraint of land."""
