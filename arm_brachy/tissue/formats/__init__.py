"""Files of meshes and surfaces, format by format."""
