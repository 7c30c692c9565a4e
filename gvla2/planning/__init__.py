"""From a labelled 3D scene and an instruction to checked waypoints."""
