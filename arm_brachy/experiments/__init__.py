"""One file per published table, figure or recording, named after it; `catalogue` lists them."""
