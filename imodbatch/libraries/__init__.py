"""Large libraries made to import."""
