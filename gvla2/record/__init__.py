"""The output of a run: result, trajectory, pictures, animation and a page."""
