"""``csv.h``, the same for all problems: reads tables, writes texts that no terminal or spreadsheet obeys."""

CSV = r"""/* Comma-separated tables with names in the first row; fields may stand in double quotes. */

#ifndef CSV__H
#define CSV__H

#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct csv {
    const char *path;
    char *text;        /* the file, its fields ended by zeros */
    char **fields;     /* row by row, the names first */
    long columns, rows;    /* rows without the names */
};

/* Ranges of characters that no terminal should be given: controls, marks that are not seen or turn the direction of
 * the text, and those that mean something to some program only. */
static const unsigned long csv_hidden[][2] = {
    {0x00, 0x1F}, {0x7F, 0x9F}, {0xAD, 0xAD}, {0x600, 0x605}, {0x61C, 0x61C}, {0x6DD, 0x6DD}, {0x70F, 0x70F},
    {0x890, 0x891}, {0x8E2, 0x8E2}, {0x180E, 0x180E}, {0x200B, 0x200F}, {0x2028, 0x202E}, {0x2060, 0x206F},
    {0xE000, 0xF8FF}, {0xFEFF, 0xFEFF}, {0xFFF9, 0xFFFB}, {0xFFFE, 0xFFFF}, {0x110BD, 0x110BD}, {0x110CD, 0x110CD},
    {0x13430, 0x1343F}, {0x1BCA0, 0x1BCA3}, {0x1D173, 0x1D17A}, {0xE0000, 0xE00FF}, {0xE01F0, 0x10FFFF}
};

/* Characters that are a blank. */
static const unsigned long csv_blank[][2] = {
    {0x09, 0x0D}, {0x1C, 0x20}, {0x85, 0x85}, {0xA0, 0xA0}, {0x1680, 0x1680}, {0x2000, 0x200A}, {0x2028, 0x2029},
    {0x202F, 0x202F}, {0x205F, 0x205F}, {0x3000, 0x3000}
};

static inline int csv_among(unsigned long character, const unsigned long (*ranges)[2], size_t count)
{
    size_t i;
    for (i = 0; i < count; i++)
        if (ranges[i][0] <= character && character <= ranges[i][1])
            return 1;
    return 0;
}

/* The character at the beginning of a text in UTF-8, and how many bytes it takes; 0 for a byte that is none. */
static inline unsigned long csv_character(const char *text, int *bytes)
{
    const unsigned char *at = (const unsigned char *)text;
    const int more = at[0] < 0x80 ? 0 : at[0] < 0xC2 ? -1 : at[0] < 0xE0 ? 1 : at[0] < 0xF0 ? 2 : at[0] < 0xF5 ? 3 : -1;
    unsigned long character = more <= 0 ? at[0] : at[0] & (0x3FU >> more);
    int i;

    *bytes = 1;
    for (i = 1; i <= more; i++) {
        if ((at[i] & 0xC0) != 0x80)
            return 0;
        character = character << 6 | (at[i] & 0x3FU);
    }
    if (more < 0 || (more == 2 && (character < 0x800 || (character >> 11) == 0x1B))
        || (more == 3 && (character < 0x10000 || character > 0x10FFFF)))
        return 0;
    *bytes = more + 1;
    return character;
}

/* A text as part of a line, as a terminal may be given it: blanks for white space of any kind, U+FFFD for what else is
 * hidden or no UTF-8. In a `field` quotes are doubled. */
static inline void csv_show(FILE *file, const char *text, int field)
{
    while (*text != '\0') {
        int bytes;
        const unsigned long character = csv_character(text, &bytes);
        if (csv_among(character, csv_blank, sizeof csv_blank / sizeof *csv_blank))
            putc(' ', file);
        else if (csv_among(character, csv_hidden, sizeof csv_hidden / sizeof *csv_hidden))
            fputs("\xEF\xBF\xBD", file);
        else
            fwrite(text, 1, (size_t)bytes, file);
        if (field && character == '"')
            putc('"', file);
        text += bytes;
    }
}

/* One field made of `count` parts: a spreadsheet, too, takes it for a text. */
static inline void csv_put(FILE *file, const char *const *parts, int count)
{
    int i, first = 0, marked = 0;

    while (first < count - 1 && parts[first][0] == '\0')
        first++;
    for (i = 0; i < count; i++)
        marked = marked || strpbrk(parts[i], ",\"") != NULL;
    if (marked)
        putc('"', file);
    if (parts[first][0] != '\0' && strchr("=+-@\t\r", parts[first][0]) != NULL)
        putc('\'', file);
    for (i = 0; i < count; i++)
        csv_show(file, parts[i], 1);
    if (marked)
        putc('"', file);
}

static inline void csv_put_text(FILE *file, const char *text)
{
    csv_put(file, &text, 1);
}

/* The field of a number's name: of the quantity, then the key of a member (NULL: there is one), of a component (0). */
static inline void csv_put_name(FILE *file, const char *name, const char *key, long component)
{
    char number[32] = "";
    const char *parts[5];

    if (component > 0)
        snprintf(number, sizeof number, "[%ld]", component);
    parts[0] = name;
    parts[1] = key == NULL ? "" : "[";
    parts[2] = key == NULL ? "" : key;
    parts[3] = key == NULL ? "" : "]";
    parts[4] = number;
    csv_put(file, parts, 5);
}

/* Says what is wrong with a file; `row` counts the rows as they stand there, the names are row 1; 0: no row. */
static inline int csv_wrong(const struct csv *table, long row, const char *column, const char *what)
{
    fputs("error: ", stderr);
    csv_show(stderr, table->path, 0);
    if (row > 0)
        fprintf(stderr, ", row %ld", row);
    if (column != NULL) {
        fputs(", column `", stderr);
        csv_show(stderr, column, 0);
        putc('`', stderr);
    }
    fputs(": ", stderr);
    csv_show(stderr, what, 0);
    putc('\n', stderr);
    return 0;
}

/* The text of a file, ended by a zero; NULL: it cannot be read to its end, or does not fit into the memory. */
static inline char *csv_whole_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    char *text = NULL;
    size_t capacity = 0, got = 1;

    *size = 0;
    if (file == NULL)
        return NULL;
    while (got > 0) {
        char *more = text;
        if (*size + 1 >= capacity)
            more = realloc(text, capacity = 2 * capacity + 4096);
        if (more == NULL)
            break;
        text = more;
        got = fread(text + *size, 1, capacity - 1 - *size, file);
        *size += got;
    }
    if (got > 0 || ferror(file)) {
        free(text);
        text = NULL;
    }
    fclose(file);
    if (text != NULL)
        text[*size] = '\0';
    return text;
}

/* One field from `*from`, written over itself without quotes and ended by a zero; the character behind it. */
static inline int csv_field(char **from, char **field)
{
    char *read = *from, *write = *from;
    int end;

    *field = write;
    if (*read == '"') {
        for (read++; *read != '\0'; read++) {
            if (*read == '"') {
                if (read[1] != '"') {
                    read++;
                    break;
                }
                read++;
            }
            *write++ = *read;
        }
    }
    while (*read != '\0' && *read != ',' && *read != '\n' && *read != '\r')
        *write++ = *read++;
    end = *read;
    if (end == '\r' && read[1] == '\n')
        read++;
    *from = end == '\0' ? read : read + 1;
    *write = '\0';
    return end;
}

static inline int csv_read(struct csv *table, const char *path)
{
    char *at;
    long capacity = 0, count = 0, line = 0;
    size_t size;

    memset(table, 0, sizeof *table);
    table->path = path;
    table->text = csv_whole_file(path, &size);
    if (table->text == NULL)
        return csv_wrong(table, 0, NULL, "cannot be read");
    if (strlen(table->text) != size)
        return csv_wrong(table, 0, NULL, "holds a NUL character");
    at = table->text;
    if (strncmp(at, "\xEF\xBB\xBF", 3) == 0)
        at += 3;
    while (*at != '\0') {
        long fields = 0;
        int end;
        line++;
        do {
            char *field;
            end = csv_field(&at, &field);
            if (count == capacity) {
                char **more = realloc(table->fields, sizeof *more * (size_t)(capacity = 2 * capacity + 256));
                if (more == NULL)
                    return csv_wrong(table, line, NULL, "does not fit into the memory");
                table->fields = more;
            }
            table->fields[count++] = field;
            fields++;
        } while (end == ',');
        if (fields == 1 && table->fields[count - 1][0] == '\0') {
            count--;
            if (*at != '\0')
                return csv_wrong(table, line, NULL, "is empty");
        } else if (line == 1) {
            table->columns = fields;
        } else if (fields != table->columns) {
            return csv_wrong(table, line, NULL, "has another number of fields than the names in row 1");
        } else {
            table->rows++;
        }
    }
    if (table->columns == 0)
        return csv_wrong(table, 0, NULL, "has no names of columns in its first row");
    return 1;
}

static inline void csv_free(struct csv *table)
{
    free(table->fields);
    free(table->text);
    memset(table, 0, sizeof *table);
}

static inline long csv_column(const struct csv *table, const char *name)
{
    long column;
    for (column = 0; column < table->columns; column++)
        if (strcmp(table->fields[column], name) == 0)
            return column;
    csv_wrong(table, 1, name, "there is no such column");
    return -1;
}

static inline const char *csv_cell(const struct csv *table, long row, long column)
{
    return table->fields[(row + 1) * table->columns + column];
}

/* A decimal number, nothing before or behind it but blanks. */
static inline int csv_number(const char *cell, double *value)
{
    const char *character;
    char *end;

    for (character = cell; *character != '\0'; character++)
        if (strchr("0123456789+-.eE \t", *character) == NULL)
            return 0;
    *value = strtod(cell, &end);
    if (end == cell)
        return 0;
    while (isspace((unsigned char)*end))
        end++;
    return *end == '\0' && *value - *value == 0.0;
}

/* A column of numbers, times `factor` plus `zero`; NULL where something is wrong, which is then said. */
static inline double *csv_numbers(const struct csv *table, const char *name, double factor, double zero)
{
    const long column = csv_column(table, name);
    double *values;
    long row;

    if (column < 0)
        return NULL;
    values = malloc(sizeof *values * (size_t)(table->rows + 1));
    if (values == NULL) {
        csv_wrong(table, 0, name, "does not fit into the memory");
        return NULL;
    }
    for (row = 0; row < table->rows; row++) {
        if (!csv_number(csv_cell(table, row, column), values + row)) {
            char what[96];
            snprintf(what, sizeof what, "`%.60s` is no number", csv_cell(table, row, column));
            csv_wrong(table, row + 2, name, what);
            free(values);
            return NULL;
        }
        values[row] = values[row] * factor + zero;
    }
    return values;
}

/* A column of texts, which stay in the table. */
static inline const char **csv_texts(const struct csv *table, const char *name)
{
    const long column = csv_column(table, name);
    const char **values;
    long row;

    if (column < 0)
        return NULL;
    values = malloc(sizeof *values * (size_t)(table->rows + 1));
    if (values == NULL) {
        csv_wrong(table, 0, name, "does not fit into the memory");
        return NULL;
    }
    for (row = 0; row < table->rows; row++)
        values[row] = csv_cell(table, row, column);
    return values;
}

#endif
"""
