"""Images, plots, pages and text files; each is written whole or not at all."""
