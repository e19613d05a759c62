"""The published figures: each number of a record, declared once with all places where people see it."""
