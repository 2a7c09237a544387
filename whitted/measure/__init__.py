"""What this installation is, and how fast and accurate it is."""
