"""The report of a sweep: groups of rows, pictures, curves, and the page that shows them."""
