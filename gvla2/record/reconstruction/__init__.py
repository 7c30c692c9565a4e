"""What `gvla2 reconstruct` leaves behind: numbers, pictures and a page that explains them."""
