"""An estimate as topics, JSON, text and files for other programs."""
