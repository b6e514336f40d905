"""When a bond breaks: criteria, strengths, damage, breaking within the sub-steps."""
