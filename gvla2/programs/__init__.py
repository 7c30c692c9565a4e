"""What language planners answer in (calls of skills, waypoints by names, array expressions): read, and doubted."""
