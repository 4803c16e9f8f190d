"""New plugin packages from templates: names, seats, files (docs/new.md). Imports neither torch nor mujoco."""
