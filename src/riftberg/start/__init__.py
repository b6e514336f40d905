"""The start of a run: arguments that agree, the parameters of the berg, its date, and what should be known of it."""
