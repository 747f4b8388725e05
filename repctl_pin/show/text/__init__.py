"""Results as text: tables, verdicts, captions and numbers."""
