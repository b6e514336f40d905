"""Which elements hang together: connectivity, the tree of fragments, contacts between them, births and deaths."""
