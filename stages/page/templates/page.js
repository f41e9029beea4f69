// Theme, sortable tables, CSV copies, and the mark of the current chapter.
{
  const root = document.documentElement, button = document.getElementById("theme");
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const label = () => { button.textContent = dark() ? "Light" : "Dark"; };
  button.addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; label(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", label);
  label();
}

document.documentElement.classList.add("js");  // rows that are filtered out can be shown again

// A link into folds opens them.
function unfold() {
  const target = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  for (let item = target; item; item = item.parentElement) if (item.tagName === "DETAILS") item.open = true;
  for (const inner of target.querySelectorAll(":scope > details")) inner.open = true;
  target.scrollIntoView();
}
addEventListener("hashchange", unfold);
unfold();
for (const link of document.querySelectorAll('a[href^="#"]')) link.addEventListener("click", () => { if (link.hash === location.hash) unfold(); });

// Rows that a table keeps back, and all folds of the page.
function showRows(figure, all) {
  const button = figure.querySelector("button.rows");
  if (!button) return;
  button.dataset.words ??= button.textContent;
  figure.classList.toggle("some", !all);
  button.setAttribute("aria-expanded", all);
  button.textContent = all ? button.dataset.fewer ?? "show identified" : button.dataset.words;
}
for (const button of document.querySelectorAll("button.rows")) button.addEventListener("click", () => showRows(button.closest("figure"), button.getAttribute("aria-expanded") === "false"));
{
  const button = document.getElementById("unfold"), folds = [...document.querySelectorAll("main details")], atFirst = folds.map(item => item.open);
  button.addEventListener("click", () => {
    const all = button.textContent === "Open all";
    folds.forEach((item, place) => { item.open = all || atFirst[place]; });
    for (const figure of document.querySelectorAll("figure.table")) showRows(figure, all);
    button.textContent = all ? "Close all" : "Open all";
  });
  document.getElementById("print").addEventListener("click", () => print());
}
for (const button of document.querySelectorAll("button.copy")) button.addEventListener("click", () => {
  const range = document.createRange(), box = button.parentElement;
  range.setStartAfter(button);
  range.setEndAfter(box.lastChild);
  getSelection().removeAllRanges();
  getSelection().addRange(range);
  document.execCommand("copy");  // works in a file that is opened from the disk
  button.textContent = "Copied";
});

function sorted(cell) {  // what it sorts by and what a copy holds: its text unless it says otherwise
  return cell.dataset.v ?? (cell.classList.contains("empty") ? undefined : cell.textContent);
}

function sortBy(table, column, head) {
  const ascending = head.getAttribute("aria-sort") !== "ascending";
  for (const other of head.parentNode.children) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", ascending ? "ascending" : "descending");
  const body = table.tBodies[0], rows = [...body.rows];
  const value = row => sorted(row.cells[column]);
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
    if (!head.textContent.trim()) return;
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
  const value = cell => table.classList.contains("sortable") ? sorted(cell) ?? "" : cell.dataset.v ?? (cell.textContent.trim().replace(/\s+/g, " ").replace("−", "-"));
  const rows = [...table.tBodies].flatMap(body => [...body.rows]).map(row => [...row.cells].map(cell => quote(value(cell))));
  return [heads, ...rows].map(row => row.join(",")).join("\n") + "\n";
}

for (const figure of document.querySelectorAll("figure.table")) {
  const table = figure.querySelector("table"), button = document.createElement("button");
  if (!table) continue;
  const name = (figure.querySelector("strong") ?? figure.closest("details").querySelector("summary")).textContent.trim();
  button.type = "button";
  button.className = "quiet csv";
  button.textContent = "CSV";
  button.setAttribute("aria-label", `Save the table ${name} as CSV`);
  figure.querySelector("figcaption").append(" ", button);
  button.addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([csv(table)], {type: "text/csv"}));
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
