"""What is to be solved: meshes, sensors, mounts, objective, options; no files, no OpenGL."""
