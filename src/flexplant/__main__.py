"""`python -m flexplant`: the command line where its script is not on the path."""

from flexplant.cli import main

if __name__ == "__main__":
    main()
