"""Teaching: classes, in which the pages of students follow the page of a teacher."""
