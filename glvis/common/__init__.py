"""What every layer may use: words of errors, reading of files, kinds of values."""
