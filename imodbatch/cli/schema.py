"""The command that prints the data dictionary."""

import click


@click.command()
@click.argument("table", required=False)
def schema(table: str | None) -> None:
    """Print the data dictionary: every table (or one), its columns, types and meaning.

    \b
    Example:
      imodbatch schema fused
    """  # noqa: D301 (click wants the character, not a backslash)
    from imodbatch.core.errors import TableError
    from imodbatch.settings.toml import did_you_mean
    from imodbatch.tables.schemas import TABLES

    if table is not None and table not in TABLES:
        raise TableError(f"{table}: no such table.{did_you_mean(table, list(TABLES))}")
    for spec in TABLES.values() if table is None else (TABLES[table],):
        place = "run" if spec.per_run else "<sequence_id>"
        click.echo(f"{spec.name}/{place}.parquet (version {spec.version})")
        for column in spec.columns:
            name = column.name.upper() if column.name in spec.key else column.name
            nullable = "?" if column.nullable else ""
            click.echo(f"  {name:20} {str(column.dtype) + nullable:16} {column.meaning}")
