"""`python -m latentmotion` is `latentmotion`."""

from latentmotion.cli.main import main

main()
