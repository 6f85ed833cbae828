"""What a method is given: cameras, views with their maps, distant light, and colour spaces."""
