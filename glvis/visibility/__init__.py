"""From poses to visibility maps (Sec. 2.1): filters, and engines that cast, draw or trace."""
