"""What a run leaves behind: result, trajectory, pictures, animation and one page to look at."""
