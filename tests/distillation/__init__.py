"""Students of policies: their course, their files, their scores."""
