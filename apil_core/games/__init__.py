"""Games as other libraries see them, and games of other libraries."""
