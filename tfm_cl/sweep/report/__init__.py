"""What a sweep's report is made of: groups of rows, pictures, curves, and the page they go into."""
