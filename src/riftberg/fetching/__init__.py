"""Getting data: downloads that go on where they stopped, services and their logins."""
