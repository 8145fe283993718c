"""Files of human motion, one reader a format; `table` lists them."""
