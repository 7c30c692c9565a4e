"""What a bank learns and keeps: admission, consolidation, governance, replay."""
