// Theme, sortable tables, CSV copies, and the mark of the current chapter.
{
  const root = document.documentElement, button = document.getElementById("theme");
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const label = () => { button.textContent = dark() ? "Light" : "Dark"; };
  button.addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; label(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", label);
  label();
}

// A link to a folded part unfolds it.
function unfold() {
  const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const part = target && target.querySelector(":scope > details.part");
  if (part) { part.open = true; target.scrollIntoView(); }
}
addEventListener("hashchange", unfold);
unfold();
for (const link of document.querySelectorAll("nav a")) link.addEventListener("click", () => { if (link.hash === location.hash) unfold(); });

// What is folded away on the screen is printed.
addEventListener("beforeprint", () => { for (const item of document.querySelectorAll("main details")) item.open = true; });

function sortBy(table, column, head) {
  const ascending = head.getAttribute("aria-sort") !== "ascending";
  for (const other of head.parentNode.children) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", ascending ? "ascending" : "descending");
  const body = table.tBodies[0], rows = [...body.rows];
  const value = row => row.cells[column].dataset.v;
  const numeric = rows.every(row => value(row) === undefined || row.cells[column].classList.contains("number"));
  rows.sort((a, b) => {
    const [first, second] = [value(a), value(b)];
    if (first === undefined || second === undefined) return (first === undefined) - (second === undefined);
    const order = numeric ? first - second : first.localeCompare(second, "en", {numeric: true});
    return ascending ? order : -order;
  });
  body.append(...rows);
}

for (const table of document.querySelectorAll("table.sortable")) {
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    const cells = [...table.tBodies[0].rows].map(row => row.cells[column]);
    head.classList.toggle("right", cells.some(cell => cell.classList.contains("number")));
    button.addEventListener("click", () => sortBy(table, column, head));
  });
}

function csv(table) {
  const safe = words => /^[=+@\t\r]|^-(?![\d.])/.test(words) ? `'${words}` : words;  // a spreadsheet takes these for formulas
  const plain = words => /[",\n]/.test(words) ? `"${words.replaceAll('"', '""')}"` : words;
  const quote = words => plain(safe(words));
  const heads = [...table.tHead.rows[0].cells].map(cell => quote(cell.textContent.trim()));
  const rows = [...table.tBodies[0].rows].map(row => [...row.cells].map(cell => quote(cell.dataset.v ?? "")));
  return [heads, ...rows].map(row => row.join(",")).join("\n") + "\n";
}

for (const button of document.querySelectorAll("button.csv")) {
  const figure = button.closest("figure"), name = figure.querySelector("strong").textContent;
  button.setAttribute("aria-label", `Save the table ${name} as CSV`);
  button.addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([csv(figure.querySelector("table"))], {type: "text/csv"}));
    link.download = `${name.toLowerCase().replace(/[^a-z0-9]+/g, "_")}.csv`;
    link.click();
    URL.revokeObjectURL(link.href);
  });
}

if (matchMedia("(max-width: 900px)").matches) document.querySelector("nav details").open = false;

{
  const links = new Map([...document.querySelectorAll("nav a")].map(link => [link.hash.slice(1), link]));
  const watcher = new IntersectionObserver(entries => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      for (const link of links.values()) link.removeAttribute("aria-current");
      links.get(entry.target.id)?.setAttribute("aria-current", "true");
    }
  }, {rootMargin: "-10% 0px -80% 0px"});
  for (const target of document.querySelectorAll("#summary, .chapter")) watcher.observe(target);
}
