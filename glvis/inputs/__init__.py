"""What the user writes: study files, meshes, sensors, mounts; read, checked, ready to run."""
