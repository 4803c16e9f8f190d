"""Ground that everything stands on: errors, files, seeds, statistics, documents."""
