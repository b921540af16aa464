"""What fills space with density."""
