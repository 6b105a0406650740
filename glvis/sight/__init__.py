"""The visibility analysis, Sec. 2.1 of the paper: from poses to maps, through OpenGL."""
