"""The study file: TOML read, checked, overridden, and written for whoever begins."""
