"""What there is: things, their parameters, and the files that describe them. No rays."""
