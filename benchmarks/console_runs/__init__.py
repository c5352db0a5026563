"""Who looks at the console's page, and how."""
