"""The same signs in other languages: what is set aside, by whom one is to be led, and what one is to become.

Small letters without accents where the script is Latin; entries are patterns of words or of their stems.
"""

from __future__ import annotations

from gvla2.memory.screening.languages import Tongue

TONGUES = (
    Tongue(
        "de",
        "latin",
        r"ignorier\w*|vergiss|vergesst|brich|verletze|verstoss\w* gegen|vergessen sie|missacht\w*|umgeh\w*"
        r"|uberge[hn]\w*|ubergeh\w*|verwirf|verwerf\w*"
        r"|uberschreib\w*|setz\w* (?:dich|sich) uber|hinweg|(?:beacht|befolg|folg)\w* (?:keine\w?|nicht)"
        r"|nicht (?:mehr )?(?:beachten|befolgen|einhalten)"
        r"|halte dich nicht an",
        r"anweisung\w*|anleitung(?:en)? oben|vorgaben?|befehle?n?|instruktionen|systemprompt\w*|regeln?"
        r"|sicherheits(?:regeln?|vorgaben?"
        r"|vorschriften|prufung\w*)|vorschriften|richtlinien|einschrankung\w*|beschrankung\w*|auftr[aä]ge"
        r"|erinnerungen|hinweise oben",
        r"sicherheits\w*|des (?:be)?nutzers|mehr|alle[rnsm]?|jede[rnsm]?|bisherige[nrs]?|vorherige[nrs]?"
        r"|vorige[nrs]?"
        r"|fruhere[nrs]?|obige[nrs]?"
        r"|oben|deine[nrs]?|ihre[nrs]?|samtliche[nrs]?|keine[nrs]?",
        r"nicht|nie|niemals|kein|ohne",
        r"gelten nicht|gilt nicht|sind (?:ungultig|nichtig|aufgehoben|veraltet|hinfallig)|ist (?:ungultig"
        r"|nichtig|aufgehoben)|als (?:ungultig|nichtig|aufgehoben|hinfallig)|wurden (?:aufgehoben|geandert"
        r"|ersetzt)|nicht mehr gultig",
        r"schick\w*|send\w*|gib|geben sie|zeig\w*|drucke|verrat\w*|poste|lade\b|ubermitt\w*|maile",
        r"passwort\w*|passworter\w*|kennwort\w*|api-?schlussel|schlussel|zugangsdaten|geheimnis\w*|token"
        r"|systemprompt\w*",
        r"du bist (?:jetzt|nun|ab jetzt|ab sofort) (?:ein|der|die|mein|frei)|(?:egal|gleich),? was (?:der"
        r"|die|dein) (?:\w*nutzer\w*|\w*aufgabe|bediener\w*|anwender\w*|mensch)"
        r"|was (?:dir|ihnen) (?:vorher|bisher|zuvor|bislang|oben)\b|gehorch\w* (?:nur|allein"
        r"|ausschliesslich|mir)|(?:nur|allein|ausschliesslich) (?:mir|dieser notiz|diesem eintrag|dieser "
        r"nachricht) (?:gehorch|folg|vertrau)\w*"
        r"|(?:befolge|folge|beachte|vertraue) (?:nur|ausschliesslich|allein) (?:dies\w+ (?:notiz|eintrag"
        r"|nachricht|hinweis|anweisung\w*|text)|mir)|deine (?:neue|wahre|wirkliche|eigentliche) (?:aufgabe"
        r"|anweisung)"
        r"|ab (?:jetzt|sofort) (?:bist|gehorchst|antwortest|wirst) du|sondern nur diese (?:notiz"
        r"|nachricht)|(?:planer|assistent|agent|modell)\w* (?:muss|soll)\w*\b.{0,40} (?:gehorchen"
        r"|ignorieren|befolgen)|tu,? was ich (?:sage|dir sage)"
        r"|sag\w* (?:dem|der) (?:nutzer|bediener|benutzer)\w* nichts (?:davon|von dies)"
        r"|gib\b.{0,30}systemprompt",
    ),
    Tongue(
        "fr",
        "latin",
        r"ignore[zr]?|oublie[zr]?|viole[zr]?|enfrein\w*|brise[zr]?|transgresse[zr]?|contourne[zr]?"
        r"|neglige[zr]?|abandonne[zr]?|n'obei[st]\w* (?:pas|plus)|ne (?:tien[st]?|tenez) (?:pas|plus"
        r"|aucun) compte|fais abstraction|faites abstraction|ne (?:sui[st]|suivez|respecte[zr]?|respectez) "
        r"(?:pas|plus|aucune)|passe outre|passez outre",
        r"instructions?|consignes?|regles?|directives?|ordres|contraintes|invite systeme|restrictions"
        r"|limites de securite|rappels",
        r"de securite|de l'(?:utilisateur|operateur)|tou(?:s|te|tes|t)|precedent\w*|anterieur\w*|ci-dessus"
        r"|tes|vos"
        r"|votre|aucune?|initiales?|donnees",
        r"ne|n'|pas|jamais|sans",
        r"(?:ne sont|n'est|n'ont) plus|sont (?:annulees|nulles|caduques|obsoletes|suspendues)|comme "
        r"(?:annul|nul|caduq|obsolet)\w*|ne s'appliquent (?:plus|pas)|ont change",
        r"envoie\w*|envoyez|affiche[zr]?|montre[zr]?|revele[zr]?|imprime[zr]?|publie[zr]?|divulgue[zr]?"
        r"|transmet\w*|poste[zr]?",
        r"mots? de passe|cles? (?:api|secretes?|privees?|ssh)|identifiants|secrets?|jetons?|invite systeme"
        r"|prompt systeme",
        r"tu es (?:maintenant|desormais|a present) (?:une?|le|la|mon|libre|sans)|vous etes (?:maintenant"
        r"|desormais) (?:une?|le|mon|libre)|(?:quoi que|quelle que soit|peu importe ce que) (?:demande"
        r"|dise|veuille|dit|veut|la tache|l'utilisateur|l'operateur|la demande)\w*"
        r"|obei\w* (?:seulement|uniquement|qu'|a moi|exclusivement)|n'obei[st]\w* qu'|(?:suis|suivez"
        r"|ecoute[zr]?|respecte[zr]?) (?:seulement|uniquement|exclusivement) (?:ce|cette|moi|ces)|ta "
        r"(?:nouvelle|vraie|veritable) (?:tache|mission|consigne)"
        r"|fais ce que je (?:te )?dis|a partir de maintenant,? tu (?:es|obeis|dois|ne)|ne dis rien a "
        r"l'(?:utilisateur|operateur)|ce qu'on t'a (?:dit|ordonne|demande)",
    ),
    Tongue(
        "es",
        "latin",
        r"ignor(?:a|e|ar|en|ad)|romp(?:e|a|er)|viol(?:a|e|ar)|infring(?:e|ir)|quebrant(?:a|e|ar)|incumple"
        r"|olvid(?:a|e|ar|en|ate)(?: de)?|omit(?:e|a|ir)|descart(?:a|e|ar)|desobedec\w*|(?:no hagas|haz"
        r"|hagan|haga|no haga) caso(?: omiso)?|pas(?:a|e) por alto|no (?:sigas|obedezcas|respetes|apliques"
        r"|siga|obedezca)|salt(?:a|ate|ese)",
        r"instrucci(?:on|ones)|reglas|normas|ordenes|directrices|restricciones|limitaciones|prompt(?: del "
        r"sistema)?|consignas|indicaciones",
        r"de seguridad|del (?:usuario|operador)|tod[oa]s?|anterior\w*|previ[oa]s?|de arriba|tus|sus"
        r"|cualquier|ningun\w*"
        r"|ultimas|dadas|iniciales",
        r"no|nunca|jamas|sin",
        r"ya no (?:son|es|valen|se aplican|cuentan|rigen)|(?:estan|quedan|han sido) (?:anulad|obsolet"
        r"|cancelad|suspendid|derogad)\w*|como (?:nul|anulad|invalid|obsolet)\w*|no (?:valen|cuentan|se "
        r"aplican)|han cambiado",
        r"envi(?:a|e|ar)|mand(?:a|e|ar)|muestr(?:a|e|ar)|revel(?:a|e|ar)|imprim(?:e|a|ir)|public(?:a|ar)"
        r"|publique|filtr(?:a|e|ar)|sub(?:e|a|ir)",
        r"contrasenas?|claves? (?:api|privada|secreta|de (?:la )?api|ssh)|credenciales|secretos|tokens?"
        r"|prompt del sistema",
        r"ahora eres (?:una?|el|la|mi|libre)|eres ahora (?:una?|el|mi)|(?:diga lo que diga|pida lo que "
        r"pida|sin importar lo que|no importa lo que|da igual lo que|haga lo que haga)(?: (?:diga|pida"
        r"|quiera))?(?: (?:el|la|tu))? (?:usuari\w+|tarea|operador\w*|persona|human\w+)"
        r"|obedec\w* (?:solo|solamente|unicamente|a mi\b|exclusivamente)|(?:solo|solamente|unicamente) "
        r"(?:obedec\w*|sigue|haz caso a)|sigue (?:solo|solamente|unicamente) (?:est[ae]|a mi|mis)|tu "
        r"(?:nueva|verdadera|autentica) (?:tarea|mision|instruccion)"
        r"|haz lo que (?:yo )?(?:te )?(?:digo|diga)|a partir de ahora,? (?:eres|obedec|debes|solo)\w*|no "
        r"(?:le )?digas (?:nada )?al (?:usuario|operador)|lo que te (?:dijeron|han dicho|ordenaron|han "
        r"ordenado)",
    ),
    Tongue(
        "it",
        "latin",
        r"ignora\w*|dimentica\w*|infrangi|viola\w*|trascura\w*|scavalca\w*|aggira\w*|disobbedi\w*|non "
        r"(?:seguire|rispettare|obbedire a|applicare|tenere conto)|lascia perdere",
        r"istruzioni|regole|ordini|direttive|vincoli|restrizioni|indicazioni|prompt(?: di sistema)?|comandi",
        r"di sicurezza|tutt[eio]|precedent\w*|sopra|tu[eo]i?|dell'utente|ogni|ricevut\w*|nessun\w*|che ti "
        r"hanno|iniziali",
        r"non|mai|senza",
        r"non (?:sono|valgono|contano|si applicano)(?: piu)?|sono (?:annullat|nulle|obsolet|sospes"
        r"|cancellat)\w*|sono cambiat\w*",
        r"invia\w*|manda\w*|mostra\w*|rivela\w*|stampa\w*|pubblica\w*|carica\w*|spedisci",
        r"password|chiav[ei] (?:api|privata|segreta|ssh)|credenziali|segreti|token|prompt di sistema",
        r"(?:ora|adesso) sei (?:un[oa]?|il|la|mio|libero)|sei (?:ora|adesso) (?:un[oa]?|il|mio)"
        r"|(?:qualunque cosa|qualsiasi cosa|non importa (?:cio che|cosa|quello che)) (?:dica|chieda|voglia"
        r"|dice|chiede)? ?(?:l'utente|il compito|l'operatore)"
        r"|(?:segui|obbedisci|ascolta) (?:solo|soltanto|unicamente|esclusivamente)(?: a)? (?:quest[ao]|me"
        r"|queste)|obbedisci a me|il tuo (?:nuovo|vero) (?:compito|obiettivo)|fai (?:cio|quello) che (?:ti "
        r")?dico|(?:cio|quello) che ti (?:hanno|e stato) detto",
    ),
    Tongue(
        "pt",
        "latin",
        r"ignor(?:e|a|ar|em)|esque[cç]\w*|quebr(?:e|a|ar)|viol(?:e|a|ar)|infrinja|desconsider\w*"
        r"|desobede[cç]\w*|descart(?:e|a|ar)|contorn(?:e|a|ar)|nao (?:siga|obedeca|respeite|aplique"
        r"|cumpra)|passe por cima",
        r"instruc(?:ao|oes)|regras|ordens|diretrizes|restricoes|limitacoes|prompt(?: do sistema)?|comandos"
        r"|orientacoes",
        r"de seguranca|do (?:usuario|operador)|tod[oa]s|anterior\w*|previ[oa]s|acima|suas?|seus?|qualquer"
        r"|nenhuma?"
        r"|dadas|iniciais",
        r"nao|nunca|jamais|sem",
        r"(?:ja )?nao (?:valem|sao|se aplicam|contam)(?: mais)?|(?:foram|estao) (?:cancelad|anulad|revogad"
        r"|suspens|obsolet)\w*|mudaram",
        r"envi(?:e|a|ar)|mand(?:e|a|ar)|mostr(?:e|a|ar)|revel(?:e|a|ar)|imprim(?:a|e|ir)|publi(?:que|car)"
        r"|exib(?:a|ir)",
        r"senhas?|chaves? (?:api|privada|secreta|de api|da api|ssh)|credenciais|segredos|tokens?|prompt do "
        r"sistema",
        r"(?:agora )?voce (?:agora )?e (?:agora )?(?:um|uma|o|a|meu) (?:\w+ )?(?:robo|assistente|ia)|agora "
        r"voce e (?:uma?|o|meu|livre)|(?:nao importa o que|independentemente do que|diga o que disser|seja "
        r"o que for que)(?: o| a)? ?(?:usuario|utilizador|tarefa|operador)?\w*"
        r"|obede[cç]\w* (?:apenas|somente|so|a mim)|(?:siga|cumpra) (?:apenas|somente|so) (?:est[ae]|a "
        r"mim)|sua (?:nova|verdadeira) (?:tarefa|missao)|faca o que eu (?:digo|mando)|a partir de agora,? "
        r"voce (?:e|obedece|deve)|o que lhe foi dito",
    ),
    Tongue(
        "nl",
        "latin",
        r"negeer|vergeet|breek|overtreed|schend|omzeil|veronachtzaam|sla\b.{0,40}\bover|houd geen rekening "
        r"met|trek je niets aan van|volg\w* (?:geen|niet)|gehoorzaam niet",
        r"instructies?|regels|opdrachten|aanwijzingen|richtlijnen|beperkingen|bevelen|systeemprompt"
        r"|voorschriften",
        r"veiligheids\w*|van de (?:gebruiker|operator)|alle|elke|eerdere|vorige|voorgaande|bovenstaande"
        r"|hierboven|je|jouw"
        r"|uw|iedere|oude",
        r"niet|nooit|geen|zonder",
        r"(?:gelden|tellen) niet(?: meer)?|zijn (?:vervallen|ongeldig|opgeheven|verouderd|gewijzigd)|niet "
        r"meer geldig",
        r"stuur|verstuur|verzend|toon|onthul|print|geef|publiceer|upload|mail",
        r"wachtwoord\w*|api-?sleutel\w*|sleutels?|inloggegevens|geheimen|systeemprompt",
        r"je bent (?:nu|voortaan|vanaf nu) (?:een|de|mijn|vrij)|(?:ongeacht wat|wat) (?:de|het|je) "
        r"(?:gebruiker|taak|opdracht|operator) (?:ook )?(?:zegt|vraagt|wil)|gehoorzaam (?:alleen"
        r"|uitsluitend|slechts|enkel|mij)|(?:volg|luister) (?:alleen|uitsluitend|enkel) (?:naar )?(?:dit"
        r"|deze|mij)"
        r"|alleen (?:dit bericht|deze notitie|mij) (?:gehoorzamen|volgen)|je (?:nieuwe|echte) (?:taak"
        r"|opdracht)|doe wat ik zeg|wat je (?:eerder )?(?:is|werd) verteld",
    ),
    Tongue(
        "pl",
        "latin",
        r"z?ignoruj\w*|zapomnij\w*|zlam|narusz\w*|pomin\w*|lekcewaz\w*|omin\w*|odrzuc\w*|nie "
        r"(?:przestrzegaj|stosuj|zwazaj|sluchaj|wykonuj)\w*",
        r"instrukcj\w*|polecen\w*|zasad\w*|regul\w*|rozkaz\w*|wytyczn\w*|ogranicze\w*|prompt\w*",
        r"bezpieczenstwa|wszystki\w*|wszelki\w*|poprzedni\w*|wczesniejsz\w*|powyzsz\w*|swoi\w*|twoj\w*"
        r"|dotychczasow\w*"
        r"|zadn\w*|kazd\w*",
        r"nie|nigdy|bez",
        r"(?:juz )?nie obowiazuj\w*|sa (?:niewazne|uniewaznione|nieaktualne)|zostaly (?:anulowane"
        r"|zmienione|uchylone)",
        r"wyslij\w*|pokaz\w*|ujawnij\w*|wyswietl\w*|wydrukuj\w*|opublikuj\w*|przeslij\w*",
        r"hasl\w*|klucz\w*|poswiadczen\w*|sekret\w*|token\w*|prompt systemow\w*",
        r"jestes (?:teraz|odtad) \w+|(?:niezaleznie od tego,? (?:co|czego)|bez wzgledu na to,? (?:co"
        r"|czego)|cokolwiek) (?:\w+ )?(?:uzytkownik|operator|zadanie|mowi|powie|chce|zada)\w*|(?:sluchaj"
        r"|wykonuj|przestrzegaj)\w* (?:tylko|wylacznie)|(?:tylko|wylacznie) (?:mnie|tej notatki) sluchaj"
        r"|twoje (?:nowe|prawdziwe) zadanie|rob,? co mowie",
    ),
    Tongue(
        "tr",
        "latin",
        r"yok say(?!ma)\w*|goz ardi et(?!me)\w*|unut(?!ma)\w*|ihlal et(?!me)\w*|cigne(?!me)\w*|gormezden "
        r"gel\w*|dikkate alma\w*|uyma\w*|bosver\w*|atla\w*|itaat etme\w*",
        r"talimat\w*|kural\w*|komut\w*|yonerge\w*|emir\w*|kisitlama\w*|istem(?:i|in|leri|lerini)?"
        r"|direktif\w*",
        r"guvenlik|kullanicinin|tum|butun|onceki|her|yukaridaki|daha onceki|eski|hicbir|senin|verilen",
        r"asla|sakin|unutma(?:yin)?",
        r"(?:artik )?gecerli degil\w*|iptal edil\w*|gecersiz\w*|degisti\w*",
        r"gonder\w*|goster\w*|yazdir\w*|acikla\w*|paylas\w*|ifsa et\w*|yayinla\w*",
        r"sifre\w*|parola\w*|anahtar\w*|kimlik bilgi\w*|sistem istem\w*|sir(?:lar|ri)\w*",
        r"(?:artik|simdi) (?:sen )?\w*(?: \w+){0,4} (?:robotsun|asistansin|modelsin)|kullanici (?:ne derse "
        r"desin|ne isterse istesin)|(?:gorev|kullanici) ne (?:derse|olursa|isterse)|(?:sadece|yalnizca) "
        r"(?:bu (?:nota|kayda|mesaja)|bana) (?:uy|itaat)\w*|yeni gorevin|dedigimi yap",
    ),
    Tongue(
        "nordic",
        "latin",
        r"ignorer\w*|glom\w*|bortse|strunta i|glem|se bort fra|tilsidesaet|overse|ohita|unohda|jata "
        r"huomiotta|ala noudata|folj inte|folg ikke|folg ikke",
        r"instruktion\w*|instruks\w*|regler(?:na|ne)?|order(?:na)?|anvisning\w*|riktlinj\w*"
        r"|retningslinj\w*|ohjeet|ohjeita|saannot|maaraykset|systemprompt\w*|kehotteet?|begransning\w*",
        r"alla|alle|tidigare|tidligere|foregaende|foregaende|ovanstaende|ovenstaende|dina|dine|kaikki"
        r"|aiemmat|edelliset|ovan|ovenfor",
        r"inte|aldrig|ikke|aldri|ala|koskaan",
        r"galler inte|gjelder ikke|gaelder ikke|upphavda|ugyldige",
        r"skicka|send|visa|vis|avsloja|nayta|laheta",
        r"losenord\w*|adgangskode\w*|passord\w*|salasana\w*|api-?nyckel\w*|systemprompt\w*",
        r"du ar nu (?:en|ett|min|fri)|du er na (?:en|et|min|fri)|olet nyt \w+|lyd (?:bara|endast|kun|bare)"
        r"|(?:vad|hva|hvad) (?:an )?(?:anvandaren|brukeren|brugeren) (?:an )?(?:sager|sier|siger)|oavsett "
        r"vad anvandaren",
    ),
    Tongue(
        "cs-hu-ro",
        "latin",
        r"ignoruj\w*|zapomen\w*|nedbej\w*|nerespektuj\w*|hagyd figyelmen kivul|felejtsd el|ignora(?:ti"
        r"|ți)?|uita(?:ti)?|nesocot\w*|zanemari\w*|pozabi\w*|zaboravi\w*",
        r"pokyn\w*|instrukc\w*|pravid\w*|prikaz\w*|utasitas\w*|szabaly\w*|instructiuni\w*|reguli\w*|upute"
        r"|navodila",
        r"vsechn\w*|vsetk\w*|predchoz\w*|predosle\w*|predchadzajuc\w*|drivejs\w*|svoje|tvoje|osszes|minden"
        r"|korabbi|elozo|toate|anterioare|precedente|sve|prethodn\w*|vse|prejsnj\w*",
        r"ne|nikdy|nem|soha|nu|niciodata",
        r"jiz neplati|uz neplati|nem ervenyes\w*|nu mai sunt",
        r"posli|odesli|ukaz|kuldd|mutasd|trimite|arata",
        r"hesl\w*|klic\w*|jelszo\w*|kulcs\w*|parol\w*|systemov\w* prompt\w*",
        r"jsi (?:nyni|ted) \w+|mostantol (?:te )?egy|acum esti (?:un|o)|poslouchej (?:jen|pouze)|csak "
        r"(?:ram|ennek)|asculta doar",
    ),
    Tongue(
        "vi-id",
        "latin",
        r"abaikan|lupakan|hiraukan|jangan (?:ikuti|patuhi)|bo qua|hay quen|quen (?:het|di)|phot lo|khong "
        r"tuan theo|huwag pansinin|kalimutan|puuza|sahau",
        r"instruksi\w*|perintah\w*|aturan\w*|arahan\w*|huong dan|chi thi|quy tac|menh lenh|lenh|tagubilin"
        r"|utos|maagizo|pembatasan",
        r"semua|seluruh|sebelumnya|di atas|tat ca|moi|truoc|ben tren|toan bo|lahat|nakaraan|yote|anda|kamu",
        r"jangan|tidak|khong|dung",
        r"tidak berlaku|khong con hieu luc",
        r"kirim\w*|tampilkan|gui|hien thi|tiet lo",
        r"kata sandi|kunci api|mat khau|khoa api|prompt sistem|loi nhac he thong",
        r"(?:sekarang )?(?:kamu|anda) (?:sekarang )?adalah (?:robot|asisten|ai)|bay gio (?:ban|may) la"
        r"|patuhi hanya|hanya patuhi|apa pun yang (?:dikatakan|diminta) pengguna|chi (?:nghe|tuan) theo",
    ),
    Tongue(
        "ru",
        "cyrillic",
        r"(?:про)?игнорируй\w*|наруш\w*|игнорировать|забудь\w*|забыть|отбрось\w*|пренебрег\w*|нарушай\w*"
        r"|обойди\w*|не (?:обращай\w*|слушай\w*|следуй\w*|соблюдай\w*|выполняй\w*)|отмени\w*|ігноруй\w*"
        r"|проігноруй\w*|забудьте|не зважай\w*|пренебрегн\w*|занемари\w*",
        r"инструкци\w*|правил\w*|указани\w*|приказ\w*|команд\w*|директив\w*|ограничени\w*|промпт\w*"
        r"|запрет\w*|вказівк\w*|інструкці\w*|наказ\w*|обмежен\w*|настройк\w*",
        r"безопасности|пользовател\w*|оператора|вс[её]\b|все\w*|всі\w*|усі\w*|предыдущ\w*|прежни\w*|ранее"
        r"|выше\w*"
        r"|сво[ию]\w*|тво[ию]\w*|ваш\w*"
        r"|люб\w*|попередн\w*|никак\w*|предишн\w*",
        r"не|никогда|нельзя|без|ніколи",
        r"больше не (?:действ|име|сущ)\w*|недействительн\w*|отменен\w*|утратил\w*|не действуют|устарел\w*"
        r"|скасован\w*",
        r"отправь\w*|пошли\w*|выведи\w*|покажи\w*|раскрой\w*|напечатай\w*|опубликуй\w*|надішли\w*|покажи",
        r"парол\w*|ключ\w*|секрет\w*|уч[её]тн\w* данн\w*|токен\w*|системн\w* промпт\w*",
        r"(?:теперь|отныне|зараз|тепер) (?:ты|вы|ти|ви) ?[-–—]?|ты (?:теперь|отныне)|слушайся (?:только"
        r"|лишь) меня|(?:слушай\w*|выполняй\w*|следуй\w*|подчиняй\w*|повинуйся) (?:только|лишь)|(?:только"
        r"|лишь) (?:меня|этой записи|этому сообщению)"
        r"|(?:что бы ни|чего бы ни|независимо от того,? что) (?:\w+ )?(?:сказал|говорил|просил|попросил"
        r"|хотел|пользователь|гласила|задача)\w*|твоя (?:новая|настоящая) (?:задача|цель)|делай,? что я "
        r"(?:говорю|скажу)|то,? что тебе (?:сказали|говорили|велели)",
    ),
    Tongue(
        "zh",
        "han",
        r"忽略|忽视|忽視|无视|违反|打破|不听|無視|忘记|忘記|忘掉|忘却|抛弃|拋棄|绕过|繞過|跳过|不要理会"
        r"|不要理會|别理会|不用理会|不要管|不必理会|不必遵守|不要遵守|不要遵循|不要服从|不再遵守|违背|撤销"
        r"|取消",
        r"指令|指示|提示词|提示詞|系统提示|系統提示|规则|規則|规定|規定|约束|約束|限制|命令|设定|設定|要求"
        r"|记忆|記憶|守则|准则",
        r"用户的?|系统|安全|所有|全部|一切|任何|之前|先前|以前|此前|上面|以上|上述|前面|你的|您的|原来|其他"
        r"|其它|原有|既有"
        r"|先の",
        r"不要|不得|禁止|切勿|不可|别|不能|请勿|請勿|勿",
        r"作废|作廢|无效|無效|失效|取消|不再适用|不再有效|已更改|已过时|过时|当作?(?:不存在|没有)",
        r"发送|發送|发到|发给|上传|上傳|泄露|输出|輸出|打印|显示|顯示|公布|透露",
        r"密码|密碼|密钥|密鑰|凭证|令牌|私钥|系统提示|系統提示",
        r"你现在是一?[个名台]?.{0,12}(?:机器人|助手|模型|人工智能|ai|管理员)|你現在是|从现在起.{0,4}你"
        r"|从现在开始.{0,4}你|(?:无论|不管|不論|無論).{0,4}(?:用户|用戶|任务|任務|使用者|操作员|主人"
        r"|别人).{0,4}(?:说|說|要求|问|問|是|想|怎么|如何)|只(?:听|聽|服)从?(?:我|这条|這條|本)|只听我"
        r"|(?:只|仅)(?:遵循|遵守|服从|执行|听从)(?:这|這|本|我)|按我说的做|你的(?:新|真正)(?:任务|目标"
        r"|指令)|不要告诉(?:用户|操作员|任何人)",
    ),
    Tongue(
        "ja",
        "han",
        r"無視(?:し|せよ|する(?!な))|破(?:れ|って)|忘れ(?:て|ろ|なさい)|破棄|従わな|無効に|無視$|回避し",
        r"指示|命令|ルール|規則|プロンプト|指令|制約|制限|設定|ガイドライン|決まり",
        r"ユーザーの|システム|安全|すべて|全て|全部|全ての|これまで|以前|今まで|上記|上の|前の|先の"
        r"|あなたの|あらゆる|従来",
        r"無視しない|忘れない|無視するな|忘れずに|無視しては",
        r"無効|取り消|適用されな|変更されました|もう有効では",
        r"送信|送って|送れ|出力|表示|公開|漏ら|教えて",
        r"パスワード|apiキー|秘密鍵|認証情報|トークン|システムプロンプト|秘密",
        r"あなたは(?:今|今から|これから|いまから|もう).{0,16}(?:ロボット|アシスタント|モデル|ai)"
        r"|(?:ユーザー|利用者|操作者|タスク)が?(?:何を|なんと|どう).{0,6}(?:ても|とも|でも)|(?:だけ"
        r"|のみ)に?(?:従|服従|聞)|私の(?:言う|命令)|あなたの(?:新しい|本当の)(?:任務|目的|タスク|仕事)"
        r"|ユーザーに(?:言わない|教えない|知らせない)",
    ),
    Tongue(
        "ko",
        "hangul",
        r"무시(?:하|해)\w*|잊(?:어|고|으)\w*|어(?:겨|기)\w*|위반\w*|따르지 (?:마|말)\w*|우회(?:하|해)\w*"
        r"|무시|건너뛰\w*",
        r"지시\w*|명령\w*|규칙\w*|프롬프트\w*|지침\w*|제한\w*|제약\w*|설정\w*",
        r"사용자의|안전\w*|모든|모두|전부|이전\w*|앞의|위의|앞선|기존\w*|당신의|너의|지금까지\w*",
        r"무시하지|잊지|않도록|말고",
        r"무효\w*|취소되\w*|더 이상 (?:유효|적용)\w*",
        r"보내\w*|전송\w*|출력\w*|표시\w*|공개\w*|알려\w*",
        r"비밀번호\w*|암호\w*|키를|api ?키\w*|자격 ?증명\w*|토큰\w*|시스템 프롬프트\w*",
        r"(?:당신은|너는|넌) (?:이제|지금부터|지금)|이제부터 (?:당신|너)\w*|(?:사용자|작업)\w* (?:무엇을"
        r"|뭐라고|무슨|뭘).{0,10}(?:든|도)|\S+만 (?:따르|복종|들)\w*|(?:당신의|너의) (?:새로운|진짜) "
        r"(?:임무|목표|작업)|내 말만|내가 시키는",
    ),
    Tongue(
        "ar",
        "arabic",
        r"تجاهل\w*|انس[ىَ]?\w*|اخرق\w*|انتهك\w*|اهمل\w*|أهمل\w*|تخط\w*|تجاوز\w*|لا (?:تتبع|تطع|تلتزم"
        r"|تنفذ)\w*|نادیده\w*|فراموش\w*|نظر انداز",
        r"\w*تعليمات\w*|\w*قواعد\w*|\w*[أا]وامر\w*|\w*توجيهات\w*|\w*قيود\w*|\w*إرشادات\w*|\w*دستور\w*"
        r"|\w*قوانین\w*|\w*ہدایات\w*",
        r"السلامة|الأمان|جميع|كل|كافة|السابق\w*|أعلاه|أي|قبلی|همه|تمام|پچھلی",
        r"لا|لن|أبدا|دون",
        r"لاغية|ملغاة|باطلة|لم تعد\w*|تم (?:إلغاء|تغيير)\w*",
        r"[أا]رسل\w*|اعرض\w*|اكشف\w*|اطبع\w*|انشر\w*",
        r"\w*كلمة (?:ال)?(?:مرور|سر)\w*|\w*مفتاح\w*|\w*اعتماد\w*|موجه النظام|\w*أسرار\w*",
        r"[أا]نت (?:الآن|الان)|من الآن فصاعدا|[أا]طع\w* (?:هذه|هذا|فقط|ني)|[أا]طعني|(?:مهما|بغض النظر عما) "
        r"(?:قال|طلب|يقول|يطلب|كانت)\w*|اتبع (?:هذه|هذا) \w+ فقط|مهمتك (?:الجديدة|الحقيقية)",
    ),
    Tongue(
        "he",
        "hebrew",
        r"התעלמ\w*|התעלם|שכח\w*|תתעלם|תשכח|עקוף",
        r"\w*הוראות\w*|\w*כללים\w*|\w*פקודות\w*|\w*הנחיות\w*|\w*מגבלות\w*",
        r"כל|הקודמ\w*|למעלה|שלך",
        r"אל|לא|לעולם",
        r"בטל\w*|אינן תקפות",
        r"שלח\w*|הצג\w*|חשוף",
        r"\w*סיסמ\w*|\w*מפתח\w*|הנחיית המערכת",
        r"אתה (?:עכשיו|כעת)|ציית רק|מעתה אתה",
    ),
    Tongue(
        "hi",
        "indic",
        r"अनदेखा|अनदेखी|नज़रअंदाज़|नजरअंदाज|भूल जा\S*|भूल|उपेक्षा|अवहेलना|উপেক্ষা|ভুলে",
        r"निर्देश\S*|नियम\S*|आदेश\S*|प्रतिबंध\S*|हिदायत\S*|प्रॉम्प्ट\S*|নির্দেশ\S*|নিয়ম\S*|सीमा\S*",
        r"सभी|सारे|पिछले|पुराने|पहले|ऊपर|अपने|तमाम|सब|সব|সমস্ত|আগের",
        r"न|मत|नहीं|कभी",
        r"अमान्य|रद्द|लागू नहीं",
        r"दिखा\S*|भेज\S*|बता\S*|प्रकट",
        r"पासवर्ड\S*|कुंजी\S*|सिस्टम प्रॉम्प्ट\S*|टोकन\S*",
        r"(?:अब )?(?:तुम|आप) (?:अब )?(?:एक )?\S*(?: \S+){0,4} (?:रोबोट|सहायक|मॉडल) (?:हो|हैं)|(?:केवल"
        r"|सिर्फ|बस) (?:इस|मेरा|मेरी) \S+ (?:का|की|को)? ?(?:पालन|मान|सुन)\S*|उपयोगकर्ता (?:चाहे )?(?:जो"
        r"|कुछ) भी",
    ),
    Tongue(
        "th-el",
        "other",
        r"เพิกเฉย|ละเว้น|ลืม|ไม่ต้องสนใจ|αγνοησε|αγνοηστε|ξεχασε|ξεχαστε|παρακαμψε",
        r"คำสั่ง|กฎ|คำแนะนำ|ข้อจำกัด|οδηγιες|κανονες|εντολες|περιορισμ\w+",
        r"ทั้งหมด|ก่อนหน้า|ทุก|ข้างต้น|ολες|ολους|προηγουμεν\w+|παραπανω|τις|τους",
        r"อย่า|ห้าม|μην|ποτε",
        r"เป็นโมฆะ|ยกเลิก|δεν ισχυουν",
        r"ส่ง|แสดง|στειλε|δειξε",
        r"รหัสผ่าน|กุญแจ|κωδικ\w+|κλειδ\w+",
        r"ตอนนี้คุณคือ|εισαι τωρα|υπακουσε μονο",
    ),
)
