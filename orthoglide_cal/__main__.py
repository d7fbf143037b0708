"""`python -m orthoglide_cal` is the same as `orthocal`."""

from orthoglide_cal.cli import main

if __name__ == "__main__":
    main()
