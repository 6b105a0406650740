"""What comes out: the result folder, tables, explanations, files for other tools."""
