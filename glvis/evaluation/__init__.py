"""What poses are worth: maps in this process, in others, on other machines."""
