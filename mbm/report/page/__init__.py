"""Result → one page that says all of it to somebody who has not seen mbm: HTML, or PDF."""
