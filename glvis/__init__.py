"""glvis finds where to put cameras and depth sensors, and proves what each of them sees."""

__version__ = "0.1.0"
