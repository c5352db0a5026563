"""What the web pages of this package share: who may use them, how they are served, drawing."""
