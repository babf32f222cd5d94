"""What many subjects have in common: a template that all are registered to, round by round, on many
workers."""
