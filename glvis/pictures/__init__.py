"""Pictures of results, drawn with OpenGL and Pillow."""
