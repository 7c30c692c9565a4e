"""The output of `gvla2 reconstruct`: numbers, pictures and a page that explains them."""
