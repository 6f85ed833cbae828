"""Light transport between surfels: directions, incident light, shading, and images."""
