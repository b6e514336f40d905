"""Who may touch whom (broad phase), islands of fragments in contact, impulses, land."""
